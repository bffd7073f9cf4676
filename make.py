import numpy as np, csv, sys, itertools, subprocess, json, os
from scipy import stats
import pyDOE3 as pd3
OUT='/tmp/w/trials/t'; os.makedirs(OUT,exist_ok=True)
rng=np.random.default_rng(7)
def sig(v,n=4):  # design-expert like
    if v!=v: return ''
    a=abs(v)
    if a>=100: return f'{v:.2f}'
    if a>=10: return f'{v:.2f}'
    if a>=1: return f'{v:.2f}'
    return f'{v:.4f}'
def pp(p): return '' if p!=p else ('< 0.0001' if p<1e-4 else f'{p:.4f}')
def sse(X,y):
    b=np.linalg.lstsq(X,y,rcond=None)[0]; r=y-X@b; return r@r
def cols(c,term):
    # term: tuple powers
    return np.prod(c**np.array(term),axis=1)
def cat(c,levels=None):
    u=np.unique(c); return np.column_stack([(c==x)*1.0-(c==u[-1]) for x in u[:-1]])
def anova(blocks,y,kind='III',beside=None,points=None,order=None):
    """blocks: list (name, matrix); beside list(name,matrix) first lines"""
    n=len(y); one=np.ones((n,1)); beside=beside or []
    B=[m for _,m in beside]
    full=np.hstack([one]+B+[m for _,m in blocks]); S=sse(full,y); dfe=n-np.linalg.matrix_rank(full)
    rows=[]
    prev=[one]
    tot=((y-y.mean())**2).sum()
    cur=one
    for nm,m in beside:
        a=sse(cur,y); cur=np.hstack([cur,m]); rows.append((nm,a-sse(cur,y),m.shape[1],None,None))
    base=sse(cur,y); 
    curv=[r for r in rows]
    mse=S/dfe if dfe else np.nan
    dfm=sum(m.shape[1] for _,m in blocks)
    def test(ss,df):
        F=ss/df/mse; return F,stats.f.sf(F,df,dfe)
    rows.append(('Model',base-S,dfm,*test(base-S,dfm)))
    for k,(nm,m) in enumerate(blocks):
        if kind=='III': X0=[b for j,(_,b) in enumerate(blocks) if j!=k]; X1=[b for _,b in blocks]
        elif kind=='I': X0=[b for j,(_,b) in enumerate(blocks) if j<k]; X1=X0+[m]
        else:
            o=order; X0=[b for j,(_,b) in enumerate(blocks) if j!=k and o[j]<=o[k]]; X1=X0+[m]
        ss=sse(np.hstack([one]+B+X0),y)-sse(np.hstack([one]+B+X1),y)
        rows.append((nm,ss,m.shape[1],*test(ss,m.shape[1])))
    rows.append(('Residual',S,dfe,None,None))
    if points is not None:
        key={}; 
        for i,p in enumerate(map(tuple,np.round(points,6))): key.setdefault(p,[]).append(i)
        pe=sum(((y[i]-y[i].mean())**2).sum() for i in map(np.array,key.values())); dfp=n-len(key); lof=S-pe; dfl=dfe-dfp
        if dfp and dfl>0:
            F=lof/dfl/(pe/dfp); rows.append(('Lack of Fit',lof,dfl,F,stats.f.sf(F,dfl,dfp))); rows.append(('Pure Error',pe,dfp,None,None))
    rows.append(('Cor Total',tot,n-1,None,None))
    return rows,full,S,dfe,tot
def write(name,head,rows): 
    with open(f'{OUT}/{name}.csv','w',newline='') as f: csv.writer(f).writerows([head,*rows])
def write_anova(name,rows,plant=None,head=('Source','Sum of Squares','df','Mean Square','F-value','p-value')):
    out=[]
    for nm,ss,df,F,p in rows:
        out.append([nm,sig(ss),df,sig(ss/df) if nm!='Cor Total' and df else '', sig(F) if F is not None else '', pp(p) if p is not None else ''])
    if plant: r,c,v=plant; out[r][c]=v(out[r][c])
    with open(f'{OUT}/{name}_anova.csv','w',newline='') as f: csv.writer(f).writerows([head,*out])
    return out
def claims(name,model=None,target=None,eq=None,quality=None,anova=True):
    t=''
    if model: t+=f'model = "{model}"\n'
    if anova: t+=f'anova = "{name}_anova.csv"\n'
    if target: t+=f'target = {target}\n'
    if eq: t+='[equation]\n'+''.join(f'"{k}" = "{v}"\n' for k,v in eq.items())
    if quality: t+='[quality]\n'+''.join(f'{k} = {v}\n' for k,v in quality.items())
    open(f'{OUT}/{name}.claims.toml','w').write(t)
L='ABCDEFGHJK'
def quad(k,order='quadratic'):
    t=[(L[i],tuple(int(j==i) for j in range(k))) for i in range(k)]
    if order!='linear': t+=[(L[i]+L[j],tuple(int(m in (i,j)) for m in range(k))) for i,j in itertools.combinations(range(k),2)]
    if order=='quadratic': t+=[(L[i]+'²',tuple(2*int(j==i) for j in range(k))) for i in range(k)]
    return t
def resp(c,sd=0.5,scale=1,b=None,seed=0):
    r=np.random.default_rng(seed); k=c.shape[1]; ts=quad(k)
    b=b if b is not None else r.normal(0,1.5,len(ts))
    return 33+sum(bb*cols(c,t) for bb,(n,t) in zip(b,ts))+r.normal(0,sd,len(c))
def blocksof(c,ts): return [(n,cols(c,t)[:,None]) for n,t in ts]
nat=lambda c,lo,hi:np.array(lo)+ (c+1)/2*(np.array(hi)-np.array(lo))
bump=lambda x: sig(float(x)*1.07+0.02)
LO=[0.3,0.05,0.01,2.0]; HI=[0.6,0.15,0.03,6.0]
def fmt(x): return f'{x:.6g}'
TR=[]
def trial(name,planted): TR.append((name,planted))
# 1-3 central composite
for face,al in (('rotatable',None),('spherical',None),('faced',1.0)):
    for k in (2,3):
        corners=np.array(list(itertools.product([-1,1],repeat=k)),float)
        a={'rotatable':(2**k)**.25,'spherical':k**.5,'faced':1.0}[face]
        ax=np.vstack([s*a*np.eye(k)[i] for i in range(k) for s in (-1,1)])
        c=np.vstack([corners,ax,np.zeros((5,k))]); y=np.round(resp(c,seed=k),2)
        N=nat(c,LO[:k],HI[:k]); ts=quad(k)
        for plant in (None,'ss','F','level'):
            nm=f'ccd_{face}_{k}_{plant}'
            NN=N.copy()
            rows,X,S,dfe,tot=anova(blocksof(c,ts),y,points=c)
            if plant=='level': NN[1,0]=N[0,0] if N[1,0]!=N[0,0] else N[-1,0]
            write(nm,['Std','Run',*[f'{L[i]}: f{i}' for i in range(k)],'angle of repose (deg)'],[[i+1,i+1,*[f'{v:.4g}' for v in r],f'{yy:.2f}'] for i,(r,yy) in enumerate(zip(NN,y))])
            p=None
            if plant=='ss': p=(2,1,bump)
            if plant=='F': p=(3,4,bump)
            write_anova(nm,rows,p); claims(nm,'quadratic',34); trial(nm,plant)
# unrounded
k=3;c=np.vstack([np.array(list(itertools.product([-1,1],repeat=k)),float),np.vstack([s*1.682*np.eye(k)[i] for i in range(k) for s in (-1,1)]),np.zeros((5,k))]); c=np.sign(c)*np.where(abs(c)>1.5,8**.25,abs(c))
y=resp(c,seed=33)
for plant in (None,'ss'):
    nm=f'ccd_unrounded_{plant}'; rows,*_=anova(blocksof(c,quad(k)),y,points=c)
    write(nm,['Run','A','B','C','Angle'],[[i+1,*[f'{v:.3g}' for v in r],f'{yy:.1f}'] for i,(r,yy) in enumerate(zip(nat(c,LO[:3],HI[:3]),y))])
    write_anova(nm,rows,(5,1,lambda x:sig(float(x)*1.6+1)) if plant else None); claims(nm,'quadratic'); trial(nm,plant)
# BBD actual and coded, with equations
c=pd3.bbdesign(3,center=5); y=np.round(resp(c,seed=5),2); ts=quad(3)
rows,X,S,dfe,tot=anova(blocksof(c,ts),y,points=c)
b=np.linalg.lstsq(X,y,rcond=None)[0]
N=nat(c,LO[:3],HI[:3]); XN=np.hstack([np.ones((len(y),1))]+[m for _,m in blocksof(N,ts)]); bn=np.linalg.lstsq(XN,y,rcond=None)[0]
nm_=['1']+[n.replace('²','2') for n,_ in ts]
for levels in ('coded','actual'):
  for eqk in ('coded','actual'):
    for plant in (None,'sign','coef','level','F'):
        nm=f'bbd_{levels}_eq{eqk}_{plant}'
        M=(c if levels=='coded' else N).copy()
        if plant=='level': M[4,2]=(c if levels=='coded' else N)[0,2] if False else (c if levels=='coded' else N)[:,2].sum()/17+(c if levels=='coded' else N)[:,2].max()-M[4,2] if False else [x for x in set((c if levels=='coded' else N)[:,2]) if x not in (M[4,2],sorted(set(M[:,2]))[1])][0]
        write(nm,['No.','A-sliding friction','B-rolling friction','C-surface energy','Angle of repose/deg'],[[i+1,*[fmt(v) for v in r],f'{yy:.2f}'] for i,(r,yy) in enumerate(zip(M,y))])
        bb=(b if eqk=='coded' else bn).copy()
        if plant=='sign': bb[4]*=-1
        if plant=='coef': bb[5]*=1.2
        rw=[(('%s-%s'%(n,{'A':'sliding friction','B':'rolling friction','C':'surface energy'}[n])) if n in ('A','B','C') else n,*r) for n,*r in rows]
        write_anova(nm,rw,(6,4,bump) if plant=='F' else None)
        claims(nm,'quadratic',33,dict(zip(nm_,[f'{v:.5g}' for v in bb]))); trial(nm,plant)
# reduced model
red=[t for t in ts if t[0] not in ('AB','C²')]
for plant in (None,'ss'):
    nm=f'bbd_reduced_{plant}'; rw,*_=anova(blocksof(c,red),y,points=c); write(nm,['A','B','C','y'],[[*[fmt(v) for v in r],f'{yy:.2f}'] for r,yy in zip(c,y)])
    write_anova(nm,rw,(3,1,bump) if plant else None); claims(nm,'quadratic'); trial(nm,plant)
# missing runs, three kinds
keep=[i for i in range(len(y)) if i not in (2,9)]
for kind in ('III','I','II'):
  for plant in (None,'ss'):
    nm=f'bbd_missing_{kind}_{plant}'; o=[sum(t) for _,t in ts]
    rw,*_=anova(blocksof(c[keep],ts),y[keep],kind,points=c[keep],order=o)
    write(nm,['A','B','C','y'],[[*[fmt(v) for v in r],f'{yy:.2f}'] for r,yy in zip(c[keep],y[keep])]); write_anova(nm,rw,(3,1,bump) if plant else None); claims(nm,'quadratic'); trial(nm,plant)
nm='bbd_gap_None'; write(nm,['A','B','C','y'],[[*[fmt(v) for v in r],f'{yy:.2f}' if i!=3 else ''] for i,(r,yy) in enumerate(zip(c,y))]); trial(nm,None)
nm='ccd_missing_axial_None'; cc=np.vstack([np.array(list(itertools.product([-1,1],repeat=2)),float),[[1.414,0],[0,-1.414],[0,1.414]],np.zeros((4,2))]); write(nm,['A','B','y'],[[*[fmt(v) for v in r],f'{yy:.2f}'] for r,yy in zip(cc,resp(cc))]); trial(nm,None)
nm='faced_missing_axial_None'; cc=np.vstack([np.array(list(itertools.product([-1,1],repeat=3)),float),[[1,0,0],[0,-1,0],[0,1,0],[0,0,1],[0,0,-1]],np.zeros((4,3))]); write(nm,['A','B','C','y'],[[*[fmt(v) for v in r],f'{yy:.2f}'] for r,yy in zip(cc,resp(cc))]); trial(nm,None)
# Taguchi
def tag(nm,arr,levels,names,errcol=None,plant=None,levflip=None):
    r=np.random.default_rng(len(nm)); y=30+sum(r.normal(0,1.5,int(arr[:,j].max())+1)[arr[:,j].astype(int)] for j in range(arr.shape[1]) if j!=errcol)+r.normal(0,.4,len(arr)); y=np.round(y,2)
    A=arr.copy(); 
    if levflip: A[levflip[0],levflip[1]]=(A[levflip[0],levflip[1]]+1)%(A[:,levflip[1]].max()+1)
    write(nm,['No.',*names,'repose angle'],[[i+1,*[levels[j][int(x)] for j,x in enumerate(r)],f'{yy:.2f}'] for i,(r,yy) in enumerate(zip(A,y))])
    bl=[(names[j],cat(arr[:,j])) for j in range(arr.shape[1]) if j!=errcol]; rw,*_=anova(bl,y)
    rw=[('Error' if n=='Residual' else 'Total' if n=='Cor Total' else n,*x) for n,*x in rw if n!='Model']
    write_anova(nm,rw,plant); claims(nm); trial(nm,'level' if levflip else 'ss' if plant and plant[1]==1 else 'F' if plant else None)
L9=np.array([[0,0,0,0],[0,1,1,1],[0,2,2,2],[1,0,1,2],[1,1,2,0],[1,2,0,1],[2,0,2,1],[2,1,0,2],[2,2,1,0]])
lv=[['0.2','0.4','0.6'],['0.05','0.1','0.3'],['0.3','0.5','0.7'],['1e6','1e7','1e8']]
tag('L9_None',L9,lv,['A','B','C','D'],1); tag('L9_ss',L9,lv,['A','B','C','D'],1,(1,1,bump)); tag('L9_F',L9,lv,['A','B','C','D'],1,(1,4,bump)); tag('L9_level',L9,lv,['A','B','C','D'],1,None,(4,2))
L27=np.array([[a,b,(a+b)%3,(a+2*b)%3,cc,(a+cc)%3,(b+cc)%3] for a in range(3) for b in range(3) for cc in range(3)])
tag('L27_None',L27,lv+lv,['A','B','C','D','E','F','G']); tag('L27_ss',L27,lv+lv,['A','B','C','D','E','F','G'],None,(2,1,bump))
L18=np.array([[0,0,0,0,0,0,0,0],[0,0,1,1,1,1,1,1],[0,0,2,2,2,2,2,2],[0,1,0,0,1,1,2,2],[0,1,1,1,2,2,0,0],[0,1,2,2,0,0,1,1],[0,2,0,1,0,2,1,2],[0,2,1,2,1,0,2,0],[0,2,2,0,2,1,0,1],[1,0,0,2,2,1,1,0],[1,0,1,0,0,2,2,1],[1,0,2,1,1,0,0,2],[1,1,0,1,2,0,2,1],[1,1,1,2,0,1,0,2],[1,1,2,0,1,2,1,0],[1,2,0,2,1,2,0,1],[1,2,1,0,2,0,1,2],[1,2,2,1,0,1,2,0]])
tag('L18_None',L18[:,:6],[['10','20'],*lv,lv[0]],['A','B','C','D','E','F']); tag('L18_F',L18[:,:6],[['10','20'],*lv,lv[0]],['A','B','C','D','E','F'],None,(2,4,bump))
L16=np.array([[a,b,a^b,(a&1)*2^(a>>1)^b if False else (((a<<1)^(3*(a>>1))&3)&3)^b] for a in range(4) for b in range(4)])
l4=[['1','2','3','4']]*4; tag('L16_None',L16[:,:3],l4,['A','B','C'])
# L16 two-level
H=np.array(list(itertools.product([0,1],repeat=4))); l16=np.column_stack([H,H[:,0]^H[:,1],H[:,2]^H[:,3],H[:,0]^H[:,2]])
tag('L16two_None',l16,[['+','-'] if j%2 else ['-','+'] for j in range(7)],list('ABCDEFG')); tag('L16two_level',l16,[['0.2','0.4']]*7,list('ABCDEFG'),None,None,(3,2))
# PB with dummies, DX style
pb=pd3.pbdesign(11)
be=np.array([3,-2,1.5,.2,1,0.1,.3,0,0,0,0]); y=np.round(30+pb@be+rng.normal(0,.6,12),2)
for plant in (None,'ss','level'):
    nm=f'pb_dummy_{plant}'; P=pb.copy(); 
    if plant=='level': P[5,3]*=-1
    write(nm,['No.',*'ABCDEFGH','Dummy 1','Dummy 2','Dummy 3','angle'],[[i+1,*['+' if v>0 else '−' for v in r],f'{yy:.2f}'] for i,(r,yy) in enumerate(zip(P,y))])
    rw,*_=anova([('ABCDEFGH'[j],pb[:,j:j+1]) for j in range(8)],y); write_anova(nm,rw,(3,1,bump) if plant=='ss' else None); claims(nm,'linear'); trial(nm,plant)
# PB + centre with Curvature line
pc=np.vstack([pb[:,:8],np.zeros((3,8))]); y=np.round(30+pc@be[:8]+2*(~pc.any(axis=1))+rng.normal(0,.6,15),2)
for curv in (0,1):
  for plant in (None,'F'):
    nm=f'pb_centre{curv}_{plant}'; cen=(~pc.any(axis=1)).astype(float)[:,None]
    rw,*_=anova([('ABCDEFGH'[j],pc[:,j:j+1]) for j in range(8)],y,beside=[('Curvature',cen)] if curv else None,points=pc)
    if curv:  # partial
        pass
    write(nm,['run',*'ABCDEFGH','angle'],[[i+1,*[fmt(v) for v in r],f'{yy:.2f}'] for i,(r,yy) in enumerate(zip(pc,y))]); write_anova(nm,rw,(3 if curv else 2,4,bump) if plant else None); claims(nm,'linear'); trial(nm,plant)
# D-optimal-like, unbalanced
allp=np.array(list(itertools.product([-1,0,1],repeat=3)),float); idx=[0,2,6,8,18,20,24,26,1,5,13,13,13,21]; c=allp[idx]; y=np.round(resp(c,seed=9),2)
for plant in (None,'ss'):
    nm=f'dopt_{plant}'; rw,*_=anova(blocksof(c,ts),y,points=c); write(nm,['A','B','C','Response 1'],[[*[fmt(v) for v in r],f'{yy:.2f}'] for r,yy in zip(nat(c,LO[:3],HI[:3]),y)]); write_anova(nm,rw,(3,1,bump) if plant else None); claims(nm); trial(nm,plant)
# climb
c=np.arange(7)[:,None]*np.array([0.05,0.012,-0.002])+np.array([0.3,0.06,0.03]); y=28+np.arange(7)*1.2-0.15*np.arange(7)**2
nm='climb_None'; write(nm,['No.','Sliding friction','Rolling friction','Surface energy','Angle of repose','Relative error/%'],[[i+1,*[f'{v:.3f}' for v in r],f'{yy:.2f}',f'{abs(yy-31)/31*100:.2f}'] for i,(r,yy) in enumerate(zip(c,y))]); trial(nm,None)
# 3-level full factorial with categorical interactions
g=np.array(list(itertools.product(range(3),repeat=2))*2); y=np.round(30+g[:,0]*2-g[:,1]**2+g[:,0]*g[:,1]*.7+rng.normal(0,.4,18),2)
for plant in (None,'ss'):
    nm=f'full3_{plant}'; A,B=cat(g[:,0]),cat(g[:,1]); AB=np.column_stack([A[:,i]*B[:,j] for i in range(2) for j in range(2)])
    rw,*_=anova([('Speed',A),('Moisture',B),('Speed*Moisture',AB)],y); rw=[('Error' if n=='Residual' else 'Total' if n=='Cor Total' else n,*x) for n,*x in rw if n!='Model']
    write(nm,['Speed','Moisture','Rep','flux'],[[[5,8,14][a],[0,1,4][b],i//9+1,f'{yy:.2f}'] for i,((a,b),yy) in enumerate(zip(g,y))]); write_anova(nm,rw,(1,1,bump) if plant else None); claims(nm); trial(nm,plant)
# blocks: CCD in two blocks
k=2;cor=np.array(list(itertools.product([-1,1],repeat=2)),float); ax=np.vstack([s*2**.5*np.eye(2)[i] for i in range(2) for s in (-1,1)]); c=np.vstack([cor,np.zeros((3,2)),ax,np.zeros((3,2))]); blk=np.array([1]*7+[2]*7); y=np.round(resp(c,seed=2)+1.5*(blk==2),2)
for plant in (None,'ss','F'):
    nm=f'blocks_{plant}'; rw,*_=anova(blocksof(c,quad(2)),y,beside=[('Block',np.where(blk==1,1.,-1.)[:,None])],points=np.column_stack([c,blk]))
    write(nm,['Std','Run','Block','Space Type','Factor 1 A:friction','Factor 2 B:rolling','Response 1 Angle'],[[i+1,(i*5)%14+1,f'Day {b}','Factorial' if abs(r).max()==1 else 'Center' if not r.any() else 'Axial',*[fmt(round(v,4)) for v in r],f'{yy:.2f}'] for i,(r,b,yy) in enumerate(zip(c,blk,y))]); write_anova(nm,rw,(3,1,bump) if plant=='ss' else (3,4,bump) if plant else None); claims(nm,'quadratic'); trial(nm,plant)
# replicated factorial, several responses, minitab export
f=np.vstack([np.array(list(itertools.product([-1,1],repeat=3)),float)]*2); y1=np.round(30+f@[2,-1,.5]+1.1*f[:,0]*f[:,1]+rng.normal(0,.3,16),2); y2=np.round(5+f@[-.5,1,.2]+rng.normal(0,.2,16),3)
ti=quad(3,'interactions')
for plant in (None,'ss'):
    nm=f'rep_two_responses_{plant}'; rw,X,*_=anova(blocksof(f,ti),y1,points=f); b=np.linalg.lstsq(X,y1,rcond=None)[0]
    write(nm,['StdOrder','RunOrder','CenterPt','Blocks','A','B','C','Angle','Flux','FITS1','RESI1','HI1','COOK1'],[[i+1,16-i,1,1,*[fmt(v) for v in nat(r,LO[:3],HI[:3])],f'{a:.2f}',f'{q:.3f}',f'{X[i]@b:.4f}',f'{a-X[i]@b:.4f}','0.4375',f'{abs(a-X[i]@b)/3:.4f}'] for i,(r,a,q) in enumerate(zip(f,y1,y2))]); write_anova(nm,rw,(3,1,bump) if plant else None); claims(nm); trial(nm,plant)
# DX export semicolons decimal commas, Predicted etc
nm='dx_comma_None'; c=pd3.bbdesign(3,center=3); y=np.round(resp(c,seed=5),2); rw,X,*_=anova(blocksof(c,ts),y,points=c); b=np.linalg.lstsq(X,y,rcond=None)[0]; H=np.einsum('ij,ji->i',X,np.linalg.pinv(X))
with open(f'{OUT}/{nm}.csv','w') as fo:
    fo.write('Run Order;Std;Actual Value;Predicted Value;Residual;Leverage;Internally Studentized Residuals;Cook\'s Distance\n'.replace('Run Order;Std;','Run Order;Std;A: friction;B: rolling;C: energy;'))
    for i in range(len(y)): fo.write(';'.join([str(i+1),str(i+1),*[fmt(v) for v in nat(c,LO[:3],HI[:3])[i]],f'{y[i]:.2f}',f'{X[i]@b:.2f}',f'{y[i]-X[i]@b:.4f}',f'{H[i]:.3f}','0.5','0.1']).replace('.',',')+'\n')
write_anova(nm,rw); s=open(f'{OUT}/{nm}_anova.csv').read().replace(',',';').replace('.',','); open(f'{OUT}/{nm}_anova.csv','w').write(s); claims(nm,'quadratic'); trial(nm,None)
# levels with brackets and tab
nm='bracket_None'; c=pd3.bbdesign(3,center=3)
with open(f'{OUT}/{nm}.csv','w') as fo:
    fo.write('No.\tSliding friction\tRolling friction\tEnergy\tangle\n')
    for i in range(len(y)): fo.write('\t'.join([str(i+1),*[f'{n:.3g} ({int(v):+d})' for n,v in zip(nat(c,LO[:3],HI[:3])[i],c[i])],f'{y[i]:.2f}'])+'\n')
write_anova(nm,rw); claims(nm,'quadratic'); trial(nm,None)
# noncubic truth: LHS
lh=pd3.lhs(3,samples=15,seed=3) if 'seed' in pd3.lhs.__code__.co_varnames else pd3.lhs(3,samples=15); nm='lhs_None'; y=np.round(resp(2*lh-1,seed=8),2); write(nm,['A','B','C','angle','flux'],[[*[f'{v:.3f}' for v in r],f'{yy:.2f}',f'{yy*2+rng.normal():.1f}'] for r,yy in zip(lh,y)]); trial(nm,None)
json.dump(TR,open('/tmp/w/trials/list.json','w'))
